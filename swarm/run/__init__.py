"""What composes a swarm; the only code that imports agents and world.

start        the entry point
cli          the command line: verbs and flags, by theme
library      scenarios by name or file
launch       one run carried out, over Zenoh or in memory
front        progress and outcome, for people
supervisor   one world process, N robot processes, and the person who watches
crew         all these processes: what happens to them, and what is done about it
supervision  the same for one of them, as a pure state machine
child        one of them, started and signalled
inbox        what the world asks to be done to them
viewers      where it can be watched, and finished runs shown
processes    the processes of any running swarm, as the kernel sees them
census       the same, joined with what the world says of them
board        that as a table, whose columns fit the terminal
journal      what it has told whoever watches, kept as a log of its own
logbook      the logs of a run, merged
lockstep     the same swarm in one process
replay       every robot again, from a recording
difference   two runs side by side
why          what one robot saw, weighed and did at one moment; explain puts it in words
report       all that a run has left behind, for the page that tells it
export       a run as tables
sampler      what the processes of a run cost
draft        the scenario that `swarm new` writes
doctor       what a run needs of this machine
bench        what it costs
reproduce    the paper's figures and claims
"""

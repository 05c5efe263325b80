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
desk         what the world asks to be done to them
viewers      where it can be watched
processes    the processes of any running swarm, as the kernel sees them
lockstep     the same swarm in one process
replay       every robot again, from a recording
difference   two runs side by side
why          what one robot saw, weighed and did at one moment; explain puts it in words
report       all that a run has left behind, for the page that tells it
export       a run as tables
sampler      what the processes of a run cost
bench        what it costs
reproduce    the paper's figures and claims
"""

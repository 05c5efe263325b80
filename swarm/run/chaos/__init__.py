"""Whether anything stops the swarm: `swarm chaos`.

seed --schedules--> faults --memory | processes--> records --watch--> violations --shrink--> a line

schedules   what goes wrong in a run, and how bad it may get
groups      who can hear whom
reach       who could have arrived
watch       what must hold, tick by tick
memory      one run in this process
processes   one run of real processes
shrink      the smallest schedule that still does it
campaign    all runs, and what they came to
table       the same for people

Two phases in each run: while the faults last nobody may come to harm; once they are over everybody
has to arrive, within a stated time.
"""

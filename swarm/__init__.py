"""What every process of the swarm agrees on.

swarm run SCENARIO            supervisor: launches, watches, reports
  |-- world process           tick master, Zenoh router inside
  |     commands -> motion -> contact -> raycast -> radio -> one SensorFrame per robot
  |                         \\-> Rerun        \\-> MCAP
  '-- robot process 1..N      frame -> MSAM -> field | formation -> guard -> Command

geometry    poses, twists, angles
messages    who says what to whom: the one table of topics
shapes      formations by name: where followers belong
scenario    every tunable with unit and bound
palette     a colour for every robot
errors      what can go wrong outside
score       what adds up from tick to tick
metrics     stream of ticks -> summary
bus         the seam between processes; in memory here, over Zenoh in zenoh_bus
log         what a process has to say: JSON Lines
recording   MCAP out and in: container knows the format, backlog waits for the disk; salvage and
            source take a file apart, playback reads a run; findings and verdict judge it,
            mending repairs it
compare     where two ticks differ, by robot and field
run         what composes them: command line, supervisor, lock-step, replay, bench, reproduce
"""

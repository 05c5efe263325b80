"""Watching: tick records -> Rerun (live and .rrd) and Foxglove channels for the MCAP.

TickRecord -> snapshot -> foxglove -> channels for swarm.recording
                 '------> batches -> views -> live -> run.rrd, gRPC server <- viewers
                        stage, blueprint ------^                         doorway

snapshot    what every picture needs of a tick, as arrays
states      what each robot's time line shows: its mode, and what is wrong with it
foxglove    the channels that Foxglove and Rerun draw from the MCAP by themselves
bridge      the same channels live, for Foxglove
stage       what does not change: scene, colours, names
batches     some ticks as arrays, and columns of them
scene       robots, ways, slots, forces, who hears, leads and waits for whom
awareness   scan, map and circles of the leading robot
plots       curves, events, time lines
views       the table of all these
blueprint   what a viewer shows at first
layouts     the same as files: swarm.rbl for Rerun, foxglove.json for Foxglove
live        file and server, and how to start a viewer
doorway     the page around the web viewer, which comes back when the world does

TickRecord ... -> tracks -> drawing, figures -> page
             \\-> course -> incidents -> narrative, charts, traffic -> report

tracks      a whole run as arrays
drawing     what pictures are made of
figures     the pictures of the paper
page        one HTML page of pictures and claims
course      what a report needs besides: clearances, who waits, what came over each topic
incidents   what went wrong, and how well it was taken
narrative   a run in words
charts      the figures of a report
traffic     rate, jitter and loss of each topic
report      one page that tells a run, or two runs side by side
"""

import os

# Read when Rerun is first imported: it warns of files without a footer, which are meant to be so.
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=error")

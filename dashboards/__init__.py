"""Watching: tick records -> Rerun (live and .rrd) and Foxglove channels for the MCAP."""

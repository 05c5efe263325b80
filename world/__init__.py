"""Everything that is not a robot's mind.

scene        what stands in the world: circles and polygons, drawn or from the seed
motion       set-point -> twist within the limits -> exact arc, or dynamics
dynamics     twist asked for -> wheel torques -> eq. 16 -> twist and pose
contact      who touches what on the way
raycast      the lidar: beams against circles, edges and bodies
disturbance  declared errors that strike everybody: noise, latency, speeds, lost beacons
faults       what is wrong on purpose: which faults are active, what they do to commands and motors
sensors      lidars that fail
radio        who hears whom, and what of it, how late
simulation   the whole world, one tick: pure
pace         when every tick is due: rate, pauses, steps
pulse        how fast answers come in, for people who watch
process      the shell: keeps the pace, moves the messages, records
"""

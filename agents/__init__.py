"""One robot.

frame -> peers, election -> msam -> lead, seek | follow -> priority, guard -> command

peers       beacons heard -> where the peers are now; bodies of those that fell silent
election    claims, signs of life -> who leads
mission     goal and way-points, from leader to leader
assignment  rows to columns at least cost
places      which follower has which slot
health      sensors and motors that cannot be trusted
msam        ranges -> sectors -> arcs (virtual circles)         eq. 17 to 21
field       arcs, goal, peers -> forces                         eq. 22 to 38
steering    force -> set-point
controllers one's own, each a file there
seek        a goal of its own: GO, ARRIVED, FAILED
navigator   a goal of its own, by a map with memory: a package, its stages are named there
pilot       the same map and ways for who leads, and for who follows where the way is not clear
formation   slot, way-point, bearing switch                     eq. 39 to 46
pid         adaptive tracking                                   eq. 44, 47 to 64
stray       in a jam: back off
avoid       AVOID: a follower whose way is not clear
follow      a slot: FORM, or AVOID
priority    claims, who yields to whom                          eq. 65, 66
lateness    how late commands take effect
guard       never faster than can be braked
robot       all of it in order: the pure step
process     the shell: frames in, commands out
"""

"""One robot.

frame -> msam -> mode, formation, priority -> field | pid -> guard -> command

msam        ranges -> sectors -> arcs (virtual circles)         eq. 17 to 21
field       arcs, goal, peers -> forces                         eq. 22 to 38
steering    force -> set-point; gap choice, rotation memory
formation   slot, way-point, bearing switch                     eq. 39 to 46
pid         adaptive tracking                                   eq. 44, 47 to 64
priority    claims, who yields to whom                          eq. 65, 66
guard       never faster than can be braked
robot       all of it in order: the pure step
process     the shell: frames in, commands out
"""

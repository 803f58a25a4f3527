"""What shows a run, live or from its bag: a web page, a terminal, Foxglove and a 3D scene.

Viewers read what others publish. They compute nothing that a result does not hold, and
import no ROS client: ``nodes/`` and ``commands/`` feed them.
"""

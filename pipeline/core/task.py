"""The rows that a task may have, in m and rad: of the plane of parallel joints, and of space."""

PLANE, SPACE = ("x", "z", "phi"), ("x", "y", "z", "rx", "ry", "rz")

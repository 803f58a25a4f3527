"""What runs inside LinuxCNC, in its own Python: nothing of this package is imported by it."""

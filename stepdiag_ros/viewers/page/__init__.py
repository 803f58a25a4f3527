"""The live page: a run, folded into sections, and served to browsers.

No ROS client here: ``nodes/monitor.py`` feeds it with messages, ``replay`` with a bag.
"""

"""A run in a terminal: the sections of the live page, drawn as text.

No ROS client here: ``nodes/onlooker.py`` feeds the sections with messages,
``viewers/page/replay.py`` with a bag.
"""

"""The profile of Hypothesis with which its tests here run far longer."""

from hypothesis import settings
from odd_messages import MANY_TRIALS

settings.register_profile("long", max_examples=MANY_TRIALS, deadline=None)

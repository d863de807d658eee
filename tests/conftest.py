"""Settings for all tests."""

from hypothesis import settings

# No deadline: how long an example takes says something about the machine, not about the code. Derandomised: the same
# examples on every machine, so that a failure is one everywhere; to look further, run with --hypothesis-profile=search.
settings.register_profile("fixed", deadline=None, derandomize=True, max_examples=100)
settings.register_profile("search", deadline=None, max_examples=2000)
settings.load_profile("fixed")

"""Node processes started, followed and ended from the command line."""

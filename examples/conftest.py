"""What the suite shares. With strokebench installed pytest finds the fixtures by itself."""

collect_ignore = ["failing"]
"""Tests that fail on purpose; name one on the command line to see it fail."""

"""Campaigns: one TOML per published set of tables, and the code that expands, runs, scores and reports it."""

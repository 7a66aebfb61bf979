"""The motorcycle and the road under it: simulated laps."""

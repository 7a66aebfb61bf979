"""NARX soft sensors at design time: the network on plain arrays, and its training."""

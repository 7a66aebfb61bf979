"""A CAN bus for processes of one user: a hub on a unix socket, and a python-can interface to it."""

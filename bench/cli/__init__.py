"""The rim: typer commands, one a file. Only here are files, sockets and screens touched."""

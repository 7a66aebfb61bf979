"""Where the CAN layout lives: `motorcycle.dbc`, and nothing else that says where a bit goes."""

from pathlib import Path

MOTORCYCLE = Path(__file__).with_name("motorcycle.dbc")

"""The ground floor: ECUs and what is in them. Nothing here knows a lap, a bench or a screen."""

"""Plugins that any Mitsuba scene can use: a retro-reflecting sheet and a sky."""

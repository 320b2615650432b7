"""Mitsuba and Dr.Jit: the device, plugins, and the transport of spot and background light."""

"""The judge: the paper's closed forms and other published ones, written apart from the simulator."""

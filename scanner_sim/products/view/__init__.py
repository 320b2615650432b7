"""A result as one page for a browser, to turn and to click at: everything is in the file."""

"""The served door: a tracking run that another program steers through a socket."""

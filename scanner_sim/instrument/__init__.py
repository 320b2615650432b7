"""The whole instrument: scenarios in, samples, images and tracks out."""

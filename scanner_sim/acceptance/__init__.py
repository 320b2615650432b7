"""Acceptance tests: lengths, spheres and planes over the working volume, judged against a maker's limits."""

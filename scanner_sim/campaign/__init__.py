"""Many scenarios as one question: a plan, its runs, what is measured of each, and the rows that come of it."""

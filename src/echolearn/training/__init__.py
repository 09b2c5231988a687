"""A labelled set and a classifier make a run, a run makes a bundle."""

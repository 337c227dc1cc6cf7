"""Trajectories, plots and studies of legs, written against the interface that all routes share."""

"""What a torque costs from Python: every route and its peers, accuracy first, in units of one `pin.rnea`."""

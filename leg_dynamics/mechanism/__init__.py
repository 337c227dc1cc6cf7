"""Any description on pinocchio: closing the loops, constrained Jacobians, inverse and forward dynamics, mobility."""

"""From any description to CasADi graphs of its closed-loop kinematics and dynamics.

The graphs are straight-line code: the spanning tree, the loop rows, a sparse elimination with pivots fixed beforehand,
and Newton-Euler dynamics by virtual work, packaged as `leg_dynamics.kernels.program.Program` objects.
"""

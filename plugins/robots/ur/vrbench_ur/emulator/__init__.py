"""A UR controller on loopback, for tests and dry runs: `python -m vrbench_ur.emulator`.

Made from the protocol's description and from watching the real client; its arm is a kinematic twin
that follows, lags and trembles as a real one does, and doesn't know forces.
"""

"""Metrics: how wrong. Each module holds one family, its units and its functions."""

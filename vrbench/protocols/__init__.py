"""Protocols: named, versioned chains of estimators that score takes."""

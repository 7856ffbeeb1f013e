"""vrbench measures how accurately a VR headset knows where it is."""

__version__ = "0.1.0"

"""What a run is made of: its devices, what moves the headset, and one take after the other."""

"""What evaluation found before, kept by all that it rests on."""

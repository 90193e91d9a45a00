"""What to measure next: questions that the data leave open, and the designs that answer them."""

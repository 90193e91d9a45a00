"""What the codes of controls mean to ncomp, from the tables by which the interpreters read them."""

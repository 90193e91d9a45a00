"""Reference interpreters: small controls of their own, written from the meaning of the manuals.

They are to be read, not to be fast. Each executes a program with the offsets and the lengths of a machine, and gives the
moves that the control would make. They share nothing with the product, and only the form of a move with each other.
What a manual leaves to a parameter or to the control is not in them: `Unclear` names it.
"""

"""The life of machines: one database of their results and events, and the trends of their errors."""

"""The parts of a control that all dialects share: its state, its set-up, its tools."""

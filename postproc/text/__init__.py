"""The text of NC programs: lines, blocks, expressions, statements and control flow, for all dialects."""

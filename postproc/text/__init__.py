"""The text of NC programs: lines, blocks, expressions, statements and control flow, whatever the dialect."""

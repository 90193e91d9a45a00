"""From the text of ISO / Fanuc / LinuxCNC programs to blocks with words and statements."""

"""From the text of Siemens 840D programs to blocks with words and statements."""

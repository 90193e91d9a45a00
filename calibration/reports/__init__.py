"""Results of the commands for programs (JSON) and for people (terminal and page), each written once."""

"""One module for each command, with a function ``run`` that takes the options by name and gives the exit status."""

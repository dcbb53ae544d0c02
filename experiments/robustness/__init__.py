"""Studies of the commands' behaviour: files that are damaged, and commands that are killed."""

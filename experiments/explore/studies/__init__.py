"""Studies of the application in a real browser: how quick it is, and how many steps a task takes."""

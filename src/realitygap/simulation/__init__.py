"""The simulated robot at a task: engines that carry out batches of trials, and the simulated body (§3.2)."""

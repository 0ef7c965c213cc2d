"""A Khepera on a serial line: protocol, driver, clock, control loop, recordings, safe stop."""

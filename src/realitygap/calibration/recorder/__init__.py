"""Recording: what to record where, on a twin that is placed or a robot that a person places."""

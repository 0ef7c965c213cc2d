"""Recording: plans of places, with a robot that places itself or one placed by a person."""

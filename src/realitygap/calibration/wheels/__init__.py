"""The wheels: speed, lag, friction, odometry and noise, fitted from recorded drives."""

"""A Thymio II: seven infrared sensors, motors without encoders, Aseba's protocol."""

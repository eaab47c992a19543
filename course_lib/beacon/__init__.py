"""A quadrotor in a room with four beacons: geometry, Kalman and particle filters, kinodynamic planning."""

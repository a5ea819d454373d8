//! The window: it looks, and sets the pace; it changes nothing in the simulation.

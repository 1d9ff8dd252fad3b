"""Two streams, one clock: orientations at the wrench's times, and the delay between the two."""

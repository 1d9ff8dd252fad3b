"""Speed and accuracy against limits measured in the same run; `make bench` runs them all."""

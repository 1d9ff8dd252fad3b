"""Contact wrenches one sample at a time: compensation, filters, drift, contact, faults."""

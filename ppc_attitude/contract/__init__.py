"""What every floor agrees on: topics, wire format, parameters, the arrays of one run."""

//! A synthetic colon whose value, gradient and anatomy are known at every point.

"""The protocol by which algorithms are compared: suites of tasks, results in files, their check."""

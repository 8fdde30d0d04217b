"""What stepping a task costs, beside MuJoCo alone, other environments and batches."""

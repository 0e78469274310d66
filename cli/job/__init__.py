"""Parts of a render job: the checkpoints of its pictures."""

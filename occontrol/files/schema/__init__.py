"""What the problem files of all families share: the strict base model, matrices, words for mistakes, JSON Schema."""

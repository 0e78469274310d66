"""What the tests of materials share with those of the compiler: a scene from text, and what is said about it."""

from ..compiler.conftest import compiled, said

__all__ = ["compiled", "said"]

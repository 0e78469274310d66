"""The IR and a plan to an Image. From compiler/ it reads the IR and the plan, no more."""

"""Renders the IR under a plan to an Image. From compiler/ it imports the IR, the plan, formulas and meshes."""

import bpy

material = bpy.context.scene.hairloom.simulation.material
material.young = 1.7
material.stiffness_scale = 1.0
material.radius_major = 45.0
material.radius_minor = 45.0
material.density = 1700.0
material.poisson = 0.48
material.damping = 0.2
material.drag = 20.0
material.friction = 0.6
material.cohesion = 1.0

import bpy

material = bpy.context.scene.hairloom.simulation.material
material.young = 3.9
material.stiffness_scale = 1.0
material.radius_major = 28.0
material.radius_minor = 25.0
material.density = 1300.0
material.poisson = 0.48
material.damping = 0.08
material.drag = 20.0
material.friction = 0.3
material.cohesion = 0.5

// The scene of start.scene. POV-Ray is left-handed: `right` is negative. Light of 1 gives a white surface facing it 1.
#version 3.7;
global_settings { assumed_gamma 1.0 }
#default { finish { ambient 0 diffuse 1 } }
box { <-3, -0.2, -3>, <3, 0, 3> pigment { color rgb <0.6, 0.6, 0.55> } }
sphere { <-0.6, 1, 0>, 1 pigment { color rgb <0.7, 0.25, 0.15> } }
box { <0.7, 0, 0.1>, <1.7, 1, 1.1> pigment { color rgb <0.2, 0.4, 0.7> } }
light_source { <1000, 2000, 1500> color rgb 1 parallel point_at <0, 0, 0> }
camera { location <0, 3, 7> up y right -x angle 40 look_at <0, 0.6, 0> }
background { color rgb 0 }

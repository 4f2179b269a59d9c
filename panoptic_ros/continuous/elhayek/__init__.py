"""Spatio-temporal tracking of Elhayek et al. (CVPR 2012), the reference of the study and not the default.

The degrees of freedom of a skeleton are polynomials of time in overlapping segments (`polynomials`,
`skeleton`). A segment minimises E = -E_sim + alpha E_lim (`energy`). E_sim is the similarity of the skeleton
to 2D joints (`keypoints`), score maps (`score_maps`) or images (`image_term`), each view at its own
timestamp. E_lim integrates the violation of joint limits. Segments are fitted one after another (`tracking`)
and blended to a motion function that is twice continuously differentiable.
"""

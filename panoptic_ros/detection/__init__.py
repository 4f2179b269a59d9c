"""Images to 2D people and score maps, one view at a time.

In: `ViewFrame`; out: `ViewDetections` in the joints of the working skeleton, with score maps as
sparse patches where the network has maps. A network is described by a model card (`card`), run by
onnxruntime (`backends`), and read by the decoder of its family (`decoders`): MoveNet's centre heads
(Zhou et al. 2019), SimCC (Li et al. 2022), heat maps with DARK or UDP (Zhang, Huang et al. 2020),
RTMO and YOLO keypoints. `full_image` holds the networks that find everybody at once, `crops` those
that look at one person; `score_maps` cuts maps into patches with an owner, which part scores of
Joo et al. 2017 (5.1, 5.2) ask for; `input_size` follows the people of each camera, as a network
sees people of some sizes only.

Limits: people far larger than their neighbours are lost in inputs that suit the neighbours; a
network on crops gives one person per box.
"""

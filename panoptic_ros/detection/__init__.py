"""Detection: from images to 2D poses and score maps, one view at a time.

Input: `ViewFrame`. Output: `ViewDetections` in the joints of the working skeleton. Networks that have score
maps also give these, as sparse patches. A model card (`card`) describes a network. onnxruntime runs it
(`backends`). The decoder of its family reads its outputs (`decoders`): MoveNet's centre heads (Zhou et al.
2019), SimCC (Li et al. 2022), heat maps with DARK or UDP (Zhang, Huang et al. 2020), RTMO and YOLO keypoints.

`full_image` holds the networks that detect all people of an image at once. `crops` holds those that see one
person per crop. `score_maps` cuts maps into patches with an owner, as the part scores of Joo et al. 2017
(5.1, 5.2) need. `input_size` adapts the input size to the people of each camera, because a network detects
people of a limited size range only.

Limits: an input size that suits most people misses a person who is far larger. A network on crops gives one
person per box.
"""

"""Stages behind association, fed as the graph feeds them."""

from dataclasses import fields, replace

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.stage import AssemblyStage
from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.stage import AssociationStage
from panoptic_ros.domain import AssociationSet, Evidence, Groups, Prediction
from panoptic_ros.tracking.config import TrackingConfig
from panoptic_ros.tracking.stage import TrackingStage
from panoptic_ros.voting.stage import VotingStage


def unassociated(detections, joints):
    """A set of which nothing is known yet."""
    none, places = np.zeros(0, np.int64), np.zeros((0, joints))
    evidence = Evidence(
        none, none, np.zeros(1, np.int64), none, none, np.zeros((0, joints, 2)), places, places, np.zeros(0)
    )
    return AssociationSet(
        detections, evidence, Groups.empty(0, 0), none, np.zeros((0, joints, 3)), Prediction.of_nobody(joints)
    )


def seen_by(item, views):
    """Proposals of the same instant, of which other views are the source."""
    association = replace(item.association, detections=replace(item.detections, views=tuple(views)))
    return replace(item, association=association)


def associated(detections, context, **settings):
    """The association of a set that stands alone."""
    (found,) = AssociationStage(AssociationConfig(**settings), context).step(detections).outputs
    return found


class FedAssembly:
    """Assembly on proposals whose people are not associated yet; tracking tells association who was there."""

    def __init__(self, context, **settings):
        first, second = ({f.name for f in fields(config)} for config in (AssociationConfig, AssemblyConfig))
        assert set(settings) <= first | second
        self.association = AssociationStage(
            AssociationConfig(**{name: value for name, value in settings.items() if name in first}), context
        )
        self.stage = AssemblyStage(
            AssemblyConfig(**{name: value for name, value in settings.items() if name in second}), context
        )
        self.tracking = TrackingStage(TrackingConfig(), context)

    def step(self, item):
        found = self.association.step(item.detections)
        if not found.outputs:
            return found
        result = self.stage.step(replace(item, association=found.outputs[0]))
        self.association.step(self.tracking.step(result.outputs[0]).outputs[1])
        return result


class FedVoting:
    """Voting on sets that are associated one by one."""

    def __init__(self, config, context, **settings):
        self.association = AssociationStage(AssociationConfig(temporal_guidance=False, **settings), context)
        self.stage = VotingStage(config, context)

    def step(self, detections):
        self.association.reset()
        (found,) = self.association.step(detections).outputs
        return self.stage.step(found)

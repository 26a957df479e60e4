"""What happens in a scene: manoeuvres of agents, and what pairs of them do."""

from pd_editor.analysis.manoeuvres.scene_content import SceneContent, scene_content
from pd_editor.analysis.manoeuvres.scene_event import EVENT_KINDS, SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import FACTS

__all__ = ["EVENT_KINDS", "FACTS", "SceneContent", "SceneEvent", "scene_content"]

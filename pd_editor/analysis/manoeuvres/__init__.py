"""What happens in a scene: manoeuvres of agents, and what pairs of them do."""

from pd_editor.analysis.manoeuvres.events import EVENT_KINDS, SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import FACTS, SceneContent, scene_content

__all__ = ["EVENT_KINDS", "FACTS", "SceneContent", "SceneEvent", "scene_content"]

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.agent_kind import Activity, activity_at, true_activity
from pd_editor.scene.thresholds import MOVING_MPS
from tests.builders import straight_drivers

agents = st.lists(st.tuples(st.sampled_from(Activity), st.floats(0, 40)), max_size=8)


@given(agents)
def test_activities_agree_with_speeds_and_unknown_ones_stay_unknown(table):
    activity = np.array([one for one, _ in table], int)
    speed = np.array([one for _, one in table], float)
    found = activity_at(activity, speed)
    assert ((found == Activity.UNKNOWN) == (activity == Activity.UNKNOWN)).all()
    known = found != Activity.UNKNOWN
    drives = found == Activity.DRIVING
    assert (drives == (known & (speed >= MOVING_MPS))).all()
    assert (activity_at(found, speed) == found).all()
    is_parked = activity == Activity.PARKED
    assert (true_activity(is_parked, speed) != Activity.UNKNOWN).all()


def test_tracks_keep_activities_when_agents_are_taken_and_joined():
    tracks = straight_drivers([(0.0, 0.0, 0.0, 5.0), (20.0, 0.0, 0.0, 5.0)])
    assert tracks.activity.tolist() == [0, 0]
    known = tracks.with_rows(np.array([1]), activity=np.array([Activity.DRIVING]))
    assert known.taken([1, 0]).activity.tolist() == [Activity.DRIVING, 0]
    other = tracks.taken([0])
    assert known.taken([1]).joined(other).activity.tolist() == [Activity.DRIVING, 0]

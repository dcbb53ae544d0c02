"""The picture shows the waveform that was fired."""

import builtins

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

import inkjet_env
from inkjet_env.envs.rendering import draw_response, picture
from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.printhead import PeakCost, Printhead, Waveform

WAVEFORM = Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def test_the_picture_is_of_the_stated_size_and_changes_with_the_waveform():
    env = gymnasium.make(inkjet_env.ENV_ID, render_mode="rgb_array")
    env.reset(seed=0)
    pictures = [env.render()]
    for value in (0.2, 0.4):
        env.step(np.full(7, value, dtype=np.float32))
        pictures.append(env.render())
        env.reset()
    pictures.append(env.render())
    assert all(p.shape == (640, 960, 3) and p.dtype == np.uint8 for p in pictures)
    empty, one, other, empty_again = pictures
    np.testing.assert_array_equal(empty, empty_again)
    assert (one != other).any(axis=2).mean() > 0.005
    assert (one != empty).any(axis=2).mean() > 0.02


def test_the_same_waveform_gives_the_same_picture():
    response = Printhead.published().respond(WAVEFORM)
    np.testing.assert_array_equal(picture(response, PeakCost()), picture(response, PeakCost()))


def test_vector_environments_give_one_picture_a_head():
    actions = np.stack([np.full(7, 0.2), np.full(7, 0.4)]).astype(np.float32)
    single = gymnasium.make(inkjet_env.ENV_ID, render_mode="rgb_array")
    single.reset(seed=0)
    single.step(actions[1])
    envs = BipolarWaveformVecEnv(2, render_mode="rgb_array")
    envs.reset()
    envs.step(actions)
    first, second = envs.get_images()
    np.testing.assert_array_equal(second, single.render())
    assert (first != second).any()


def test_effective_and_next_peak_are_marked_where_they_are():
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    response = Printhead.published().respond(WAVEFORM)
    draw_response(axes, response, PeakCost(-5, 5, "largest"))
    marked = {
        line.get_label().split(" peak")[0]: line.get_xydata()[0] for line in axes.lines if " peak" in line.get_label()
    }
    for name, index in (("effective", 1), ("next", 2)):
        np.testing.assert_allclose(marked[name], [response.peak_times_s[index] * 1e6, response.peaks_V[index]])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("window_s", [350e-6, float("inf"), 1e-7])
@pytest.mark.parametrize("waveform", [WAVEFORM, Waveform(0, 0, 1e-6, 0, 0, 0, 0), Waveform(50, 0, 0, 0, 0, 0, 0)])
@pytest.mark.parametrize("effective", ["first", 1e3])
def test_unusual_responses_are_drawn_without_a_warning(waveform, window_s, effective):
    response = Printhead.published().respond(waveform, window_s=window_s)
    assert picture(response, PeakCost(effective=effective)).std() > 0


def test_drawing_leaves_matplotlibs_own_state_alone():
    import matplotlib

    before = dict(matplotlib.rcParams)
    picture(Printhead.published().respond(WAVEFORM), PeakCost())
    assert dict(matplotlib.rcParams) == before


def test_a_window_shows_each_waveform_and_may_be_closed_twice(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make(inkjet_env.ENV_ID, render_mode="human")
    env.reset(seed=0)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    env.step(np.full(7, 0.3, dtype=np.float32))
    assert (pygame.surfarray.array3d(pygame.display.get_surface()) != shown).any()
    assert env.render() is None
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_a_window_without_pygame_says_what_to_install(monkeypatch):
    def without_pygame(name, *rest):
        if name == "pygame":
            raise ImportError(name)
        return real_import(name, *rest)

    real_import = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", without_pygame)
    with pytest.raises(DependencyNotInstalled, match=r"pip install 'inkjet-env\[human\]'"):
        gymnasium.make(inkjet_env.ENV_ID, render_mode="human").reset()


def test_rendering_without_a_mode_warns_and_draws_nothing():
    env = gymnasium.make(inkjet_env.ENV_ID).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="needs a render mode"):
        assert env.render() is None

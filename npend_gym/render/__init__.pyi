from npend_gym.render.drawing import Scene as Scene
from npend_gym.render.painter import Frame as Frame
from npend_gym.render.painter import Painter as Painter
from npend_gym.render.painter import check_frame as check_frame
from npend_gym.render.painter import pygame_module as pygame_module
from npend_gym.render.painter import tile as tile
